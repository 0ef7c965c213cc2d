"""The report of a study of noise levels: words, tables, figures and a page."""
