"""One module for each group of claims: its checks, and the figures and tables beside them."""
