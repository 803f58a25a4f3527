"""Bags, each a run as one MCAP file: write, read, recover, summarise, import and export tables."""
