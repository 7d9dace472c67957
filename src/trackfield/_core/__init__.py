"""The compiled kernels, private."""
