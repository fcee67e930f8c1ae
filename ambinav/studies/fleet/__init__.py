"""Audits of many buildings: resumable, in processes or on a cluster, with a catalogue."""
