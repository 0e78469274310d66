# maquette in a container: docker build -t maquette . && docker run --rm -v "$PWD:/scenes" maquette render hello.scene -o hello.png
# After `make wheel` the image has compiled kernels.
FROM python:3.12-slim AS build
WORKDIR /source
COPY . .
RUN pip download --no-deps --no-index --find-links dist --dest /wheels maquette-render || pip wheel --no-deps --wheel-dir /wheels .

FROM python:3.12-slim
COPY --from=build /wheels /wheels
COPY requirements/run.txt /wheels/
RUN pip install --no-cache-dir --require-hashes -r /wheels/run.txt && pip install --no-cache-dir --no-deps /wheels/*.whl && rm -r /wheels
# Give --user "$(id -u):$(id -g)" to write pictures as another user: any user can write the cache.
RUN useradd --create-home --uid 1000 maquette && mkdir -m 1777 /cache
ENV MAQUETTE_CACHE=/cache
USER maquette
WORKDIR /scenes
ENTRYPOINT ["maquette"]
CMD ["--help"]
