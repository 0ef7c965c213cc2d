"""Who carries out work (`pool`, `processes`, `cluster`), in shares (`shard`), how far it is (`progress`)."""
