"""The compiled inner loop: arrays in, arrays out; no files, no prints, no classes."""
