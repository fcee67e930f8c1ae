"""What planners and environments ask of an ambiguity map: cost, reward, gradient."""
