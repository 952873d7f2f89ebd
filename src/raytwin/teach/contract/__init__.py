"""The functions that a student writes: what each takes and returns, its cases, its check, and files of them."""
