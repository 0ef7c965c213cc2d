"""The second study of the level of noise: its claims, tested as docs/noise-level-2.md planned them."""
