"""Rendering over a Dask cluster, or the GPUs of a machine: `DistributedRenderer`."""

from wrt.distributed.head import ClusterError as ClusterError
from wrt.distributed.head import DistributedRenderer as DistributedRenderer
from wrt.distributed.processes import Processes as Processes
from wrt.distributed.processes import devices_of as devices_of
