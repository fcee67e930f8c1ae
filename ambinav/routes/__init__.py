"""Routes: planner results, their costs, storage, comparison and drawing."""
