"""The same for ten thousand logs as for one: runners that share the work out, a store that keeps what was done."""
