"""A stage a file: the function done right, the calls that test it, and the mistakes it is known for."""
