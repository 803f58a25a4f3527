"""Sentences about results: what terminal, page, report and pictures say in the same words."""
