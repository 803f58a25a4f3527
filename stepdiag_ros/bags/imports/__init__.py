"""Measurements that other programs wrote: one module a format, found by the files' content."""
