"""What reports share: tables of figures with intervals, the criterion, filled templates."""
