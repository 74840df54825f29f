"""One model fitted to many logs: some of its parameters shared, others each log's own; the same problem as for one
log.
"""
