"""Localizers: Monte Carlo localization as in AMCL, and a Kalman filter on complete scans."""
