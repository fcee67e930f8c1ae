"""Which scanner suits a building: scanners held against each other on the same floor and routes."""
