# The editor on a CPU: docker build -t pd-editor .
FROM python:3.12-slim AS wheel
WORKDIR /source
COPY . .
RUN pip install --no-cache-dir build && python -m build --wheel --outdir /wheel

FROM python:3.12-slim
# Small builds of torch; the index of a CUDA version makes an image for a GPU.
ARG TORCH_INDEX=https://download.pytorch.org/whl/cpu
COPY constraints.txt /tmp/
RUN pip install --no-cache-dir --no-deps --constraint /tmp/constraints.txt --index-url "$TORCH_INDEX" torch
RUN --mount=from=wheel,source=/wheel,target=/wheel \
    pip install --no-cache-dir --constraint /tmp/constraints.txt /wheel/*.whl
RUN useradd --create-home editor && install --directory --owner editor /data
USER editor
WORKDIR /data
EXPOSE 8080
# Other commands of the shell may stand in the place of these words.
ENTRYPOINT ["pd-editor"]
CMD ["edit", "--host", "0.0.0.0", "--state", "/data/state", "--library", "/data/library"]
