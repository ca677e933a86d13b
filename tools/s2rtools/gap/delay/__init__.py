"""delay"""
