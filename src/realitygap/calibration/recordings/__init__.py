"""Recordings: the open format and the .sam tables, read, checked and written."""
