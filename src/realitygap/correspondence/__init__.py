"""How alike simulated and situated behaviour are, and what it is called (tables 1 and 2)."""
