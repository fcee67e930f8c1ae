"""The HTTP service: the application, its client, and their wire format."""
