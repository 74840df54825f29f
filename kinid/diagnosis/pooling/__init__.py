"""What many logs lack together: the diagnosis of a pooled model."""
