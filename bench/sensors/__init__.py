"""The sensors of the test bed: physical values in, the integer codes the data logger reads out."""
