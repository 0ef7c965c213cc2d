"""Files that nobody meant: mutated without end, they must each end in one clear line."""
