"""Pictures, all drawn with one floor figure and one table of colours."""
