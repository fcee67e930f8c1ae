"""The cheapest changes of a building and its scanner that meet a requirement."""
