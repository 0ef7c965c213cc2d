"""Who carries out work (`pool`, `processes`), how far it is (`progress`), and who may (`lock`)."""
