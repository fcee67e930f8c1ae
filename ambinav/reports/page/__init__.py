"""The page of a map in one file: data embedded in a report instead of served over HTTP."""
