"""Monte Carlo campaigns: drawn scenarios, run on all cores or a Dask cluster, judged and told."""
