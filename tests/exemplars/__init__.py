"""Controllers whose behaviour is known: what names and scales are learnt from, and what makes them anew."""
