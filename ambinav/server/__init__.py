"""The service over HTTP: the application, its client, and what both of them send."""
