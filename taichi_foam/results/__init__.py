"""Results of runs, and the folders that they are saved to and loaded from."""
