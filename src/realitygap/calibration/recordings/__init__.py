"""Recordings: reading, checking and writing the open format and `.sam` tables."""
