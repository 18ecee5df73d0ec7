"""Pictures of snapshots and results: frames, films, montages, and figures for print."""
