"""Jobs in other processes: audits, edits and plans, with progress."""
