# The one image of this project: bootstrap of a Fabric network, contract servers, embedded ledger, backend with its
# console, simulated pads and drones. compose.yaml runs it; Python and Node packages come from the locks, by hash.

# Bases: `make pin` writes their digests here where a registry answers. Others by --build-arg.
ARG PYTHON_IMAGE=python:3.11.14-slim-bookworm
ARG NODE_IMAGE=node:24.19.0-bookworm-slim

FROM ${PYTHON_IMAGE} AS sources
ENV PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_CACHE_DIR=1
COPY requirements/run.txt requirements/build.txt /build/requirements/
RUN python -m venv /opt/wonderland \
 && /opt/wonderland/bin/pip install --require-hashes --requirement /build/requirements/run.txt \
 && python -m venv /build/tools \
 && /build/tools/bin/pip install --require-hashes --requirement /build/requirements/build.txt
WORKDIR /build
COPY LICENSE ./
COPY alembic alembic
COPY backend backend
COPY chaincode chaincode
COPY edge_agent edge_agent
COPY libraries libraries
COPY ros_bridge ros_bridge
COPY simulator simulator
COPY uav_agent uav_agent
RUN PYTHONPATH=$(echo /build/backend /build/libraries/* | tr ' ' ':') \
    /opt/wonderland/bin/python -c "from wonderland_backend.commands import backend; backend()" openapi > openapi.json

FROM ${NODE_IMAGE} AS console
WORKDIR /build/frontend
COPY frontend/package.json frontend/package-lock.json frontend/.npmrc ./
RUN npm ci --no-audit --no-fund --loglevel=error
COPY frontend ./
COPY libraries/core/wonderland/messages ../libraries/core/wonderland/messages
COPY --from=sources /build/openapi.json ../openapi.json
RUN OPENAPI=/build/openapi.json npm run --silent build

FROM sources AS packages
COPY --from=console /build/frontend/dist frontend/dist
RUN /build/tools/bin/pip wheel --no-deps --no-build-isolation --wheel-dir /build/wheel \
      ./libraries/* ./backend ./chaincode ./edge_agent ./ros_bridge ./simulator ./uav_agent \
 && /opt/wonderland/bin/pip install --no-deps /build/wheel/*.whl \
 && /opt/wonderland/bin/pip uninstall --yes --quiet pip setuptools

FROM ${PYTHON_IMAGE}
# A volume that is mounted for the first time takes owner and mode of these.
RUN groupadd --gid 10001 wonderland \
 && useradd --uid 10001 --gid 10001 --no-create-home --home-dir /nonexistent --shell /usr/sbin/nologin wonderland \
 && install --directory --owner=10001 --group=10001 --mode=0750 /network /ledger /clients /secrets /world
COPY --from=packages /opt/wonderland /opt/wonderland
ENV PATH=/opt/wonderland/bin:$PATH PYTHONUNBUFFERED=1 PYTHONDONTWRITEBYTECODE=1
USER 10001:10001
CMD ["wonderland", "--help"]
