"""The command `ppc_attitude`."""
