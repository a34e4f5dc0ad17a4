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
# The CPU builds of torch: a plain torch brings gigabytes of CUDA packages. Another index: --build-arg.
ARG TORCH_INDEX=https://download.pytorch.org/whl/cpu
WORKDIR /source
COPY constraints.txt ./
RUN python -m venv /opt/vig \
    && /opt/vig/bin/pip install --no-cache-dir --constraint constraints.txt --index-url "$TORCH_INDEX" torch
COPY pyproject.toml README.md LICENSE ./
COPY src src
# The native library for any processor, as the image may run on another than it is built on.
RUN VIG_ISAS="plain;avx2;avx512" /opt/vig/bin/pip install --no-cache-dir --constraint constraints.txt '.[heic]' \
    && rm -rf /opt/vig/lib/python*/site-packages/torch/include /opt/vig/lib/python*/site-packages/torch/test

FROM ${PYTHON}
COPY --from=build /opt/vig /opt/vig
RUN useradd --create-home --uid 1000 vig && install --directory --owner vig --mode 777 /work
USER vig
ENV PATH=/opt/vig/bin:$PATH HOME=/home/vig
WORKDIR /work
EXPOSE 8080
ENTRYPOINT ["vig"]
CMD ["demo", "--no-open"]
