"""The application: routes, models of their answers, and the OpenAPI document."""
