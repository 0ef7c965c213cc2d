"""Controllers whose behaviour is known, and what is learnt from them."""
