"""A stage per file: the function done correctly, the calls that test it, and the mistakes it is known for."""
