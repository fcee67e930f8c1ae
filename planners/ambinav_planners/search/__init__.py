"""Searches over graphs of free motions: the map's lattice as a graph, and shortest paths over it.

- `graph`, `lattice_graph`, `channels`: a graph of motions, and how a map becomes one.
- `cheapest`, `alternatives`: the cheapest path, and others that may become the cheapest route.
- `labels`, `stretches`, `limit`, `limited_search`: a limit on bad metres in a row.
- `reachability`: whether any path leads from start to goal.

The rooms `belief` and `improve` use this one, which uses neither.
"""
