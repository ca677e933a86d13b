"""user_data"""
