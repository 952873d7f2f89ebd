"""Students' tracers: what they may hand in, the tests of each stage, and the mistake by its name.

A submission is loaded (`submission`), each of its functions held against the cases of its stage (`contract`, `judge`),
and what is wrong said in a sentence, by prediction: a typical mistake is named where it gives the very numbers found.
"""
