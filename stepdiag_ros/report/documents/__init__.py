"""Results as JSON documents: SI, ``null`` where a value is not known; each has a schema."""
