"""gap_history"""
