"""Work that the server gives to other processes: audits, edits and plans, with progress."""
