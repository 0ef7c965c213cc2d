"""A Khepera on its serial line."""
