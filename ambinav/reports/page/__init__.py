"""The page of a map in one file: what is embedded in a report instead of served over HTTP."""
