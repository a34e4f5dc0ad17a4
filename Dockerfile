# vig on the CPU: `vig demo` by default, any other verb.
#
#     docker build --tag vig .
#     docker run --rm --volume "$PWD:/work" vig                                # the demo, into vig-demo/
#     docker run --rm --volume "$PWD:/work" vig fit photo.jpg --out result
#     docker run --rm --volume "$PWD:/work" --publish 127.0.0.1:8080:8080 vig view photo.jpg --host 0.0.0.0
#
# Where your user is not number 1000, add --user "$(id -u):$(id -g)", so that results are yours.
ARG PYTHON=python:3.11-slim

FROM ${PYTHON} AS build
WORKDIR /source
RUN python -m venv /opt/vig
COPY constraints.txt pyproject.toml README.md LICENSE ./
COPY src src
# The native library for any processor, as the image may run on another than it is built on.
RUN VIG_ISAS="plain;avx2;avx512" /opt/vig/bin/pip install --no-cache-dir --constraint constraints.txt '.[heic]'

FROM ${PYTHON}
COPY --from=build /opt/vig /opt/vig
RUN useradd --create-home --uid 1000 vig && install --directory --owner vig --mode 777 /work
USER vig
ENV PATH=/opt/vig/bin:$PATH HOME=/home/vig
WORKDIR /work
EXPOSE 8080
ENTRYPOINT ["vig"]
CMD ["demo", "--no-open"]
