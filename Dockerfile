# The tools in a small image:  docker build -t surfelkit . && docker run --rm -v "$PWD:/data" surfelkit surfel-info FILE
# PLUGINS adds packages of plug-ins:  --build-arg PLUGINS="libsurfel0-plugin-image libsurfel0-plugin-gltf"
FROM debian:12-slim AS build
# The time that stands in the packages (docs/packages.md).
ARG SOURCE_DATE_EPOCH
COPY . /surfelkit
RUN /surfelkit/packaging/build.sh

FROM debian:12-slim
ARG PLUGINS=
RUN --mount=type=bind,from=build,source=/surfelkit,target=/surfelkit \
    /surfelkit/packaging/install.sh /surfelkit/build/package/packages surfelkit libsurfel0 $PLUGINS
WORKDIR /data
