"""Studies: configuration, one run, many runs, the store, resuming. A study is a folder."""
