"""One floor figure and one table of colours, and every picture that is drawn with them."""
