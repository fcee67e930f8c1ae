# Serves ambiguity maps over HTTP: docs/howto/docker.md.
#   docker build -t ambinav .
#   docker run --rm -p 8765:8765 -e AMBINAV_TOKEN -v "$PWD/maps:/maps" ambinav /maps/office.zarr
FROM python:3.11-slim-bookworm@sha256:0bee7276f83efd4a1ee05bbbf4281d95ed28e079220a9457f25a93e3f1e3c31b AS build

WORKDIR /src
COPY pyproject.toml README.md LICENSE NOTICE constraints.txt ./
COPY ambinav ambinav
COPY envs envs
COPY planners planners
RUN python -m venv /opt/ambinav \
    && /opt/ambinav/bin/pip install --no-cache-dir --constraint constraints.txt ".[serve]"

FROM python:3.11-slim-bookworm@sha256:0bee7276f83efd4a1ee05bbbf4281d95ed28e079220a9457f25a93e3f1e3c31b

# The owner of the files in /maps must be able to let this user read them; --user gives another one.
RUN useradd --create-home --uid 10001 ambinav
COPY --from=build /opt/ambinav /opt/ambinav
# Code is not writable for whoever runs it; what is compiled and kept lies in the user's folder.
ENV PATH=/opt/ambinav/bin:$PATH \
    PYTHONDONTWRITEBYTECODE=1 \
    PYTHONUNBUFFERED=1 \
    MPLBACKEND=agg \
    MPLCONFIGDIR=/home/ambinav/.cache/matplotlib \
    NUMBA_CACHE_DIR=/home/ambinav/.cache/numba \
    XDG_CACHE_HOME=/home/ambinav/.cache

USER 10001
WORKDIR /home/ambinav
RUN mkdir state && chmod a+rwX state
# Machine code for everything that is served. On another kind of processor it is made again, once,
# so it lies where whoever --user names can write: numba refuses to work without.
RUN building="$(python -c 'from ambinav import DEMO_BUILDING as path; print(path)')" \
    && export AMBINAV_CACHE= \
    && ambinav audit "$building" --scanner turtlebot3-lds --spacing 0.5 --save-map /tmp/warm/map.zarr -o /tmp/warm/report \
    && ambinav plan /tmp/warm/map.zarr --start 3 3 --goal 42 20 --planner reference --shortest -o /tmp/warm/route.csv \
    && ambinav serve /tmp/warm/map.zarr --port 0 --check \
    && rm -r /tmp/warm && chmod -R a+rwX /home/ambinav

# Edits, plans and audits, for the next container: docs/howto/hosting.md.
VOLUME /home/ambinav/state
EXPOSE 8765
HEALTHCHECK --interval=30s --timeout=5s --start-period=120s \
    CMD ["python", "-c", "from urllib.request import urlopen; urlopen('http://127.0.0.1:8765/v1/ready', timeout=4)"]
# Within a container localhost is the container. AMBINAV_TOKEN or AMBINAV_READ_TOKEN must be set, or
# --insecure be added to the arguments.
ENTRYPOINT ["ambinav", "serve", "--host", "0.0.0.0", "--port", "8765", "--state", "/home/ambinav/state", "--log"]
CMD ["/maps/map.zarr"]
