"""The audit: where a building leaves a scanner lost, written up for the people who commission."""
