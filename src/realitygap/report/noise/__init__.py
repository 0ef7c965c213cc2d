"""The report of a study of the level of noise: what came out, in words, tables, figures and a page."""
