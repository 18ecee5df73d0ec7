"""What a run leaves on disk: results, and the folders that they are saved to and loaded from."""
