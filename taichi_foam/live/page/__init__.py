"""A page in the browser: one run that all who look at it share, with its picture and its curve."""
