"""A class: submissions graded by a rubric, each in a sandbox, into records that pages and autograders are made of."""
