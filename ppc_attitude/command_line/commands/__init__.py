"""One file a command of `ppc_attitude`."""
