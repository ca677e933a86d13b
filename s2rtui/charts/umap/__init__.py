"""umap"""
