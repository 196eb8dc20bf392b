"""Rendering over a Dask cluster: `wrt.distributed.render`."""

from wrt.distributed.head import DistributedRenderer as DistributedRenderer
from wrt.distributed.head import render as render
