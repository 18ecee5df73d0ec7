"""What `compare.py` is made of: subjects, the processes that run them, rounds, costs, tables."""
