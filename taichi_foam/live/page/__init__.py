"""The live page in a browser: one run that all viewers share, with its picture and its curve."""
