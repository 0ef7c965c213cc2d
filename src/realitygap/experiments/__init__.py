"""What is asked of many runs: each experiment states its plan, then carries it out."""
