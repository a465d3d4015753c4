"""Field logs: what they hold (`encoding`, `foxglove`), how files are written and read (`writer`, `files`), and what is
done with them afterwards (`info`, `repair`, `export`, `merge`, `importing`). The format is described in docs/log.md."""
