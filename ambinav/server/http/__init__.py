"""The application: routes, the models of their answers, and the OpenAPI document."""
