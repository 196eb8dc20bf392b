# wrt, and a Dask worker or scheduler, for machines of a cluster (docs/clusters.md):
#   docker build -t wrt .
#   docker run --rm -v "$PWD:/work" wrt wrt render teapot.ply --part 3/16
#   docker run --rm --network host wrt dask worker tcp://head:8786 --nthreads 1
FROM python:3.12-slim

COPY . /src
RUN pip install --no-cache-dir '/src[dask]' && rm -rf /src

# Kernels are compiled at the first render of their kind, or by `wrt compile SCENE`; mount a volume here to keep them.
# Each user has a folder of their own in it.
ENV XDG_CACHE_HOME=/cache
RUN mkdir -m 1777 /cache
WORKDIR /work
CMD ["wrt", "--help"]
