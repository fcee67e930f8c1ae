"""Common parts of reports: tables of figures with intervals, the criterion, templates."""
