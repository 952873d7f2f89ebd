"""`Image(mean, variance, samples)`, its files, and the only place where sRGB exists."""
