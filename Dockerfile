# The course for a JupyterHub, for Binder, and for grading in isolation:
#   docker build -t uavdh_lite . && docker run --rm -p 8888:8888 uavdh_lite
FROM python:3.11-slim

# JupyterHub and Binder start it as this user, in its home
ENV NB_USER=jovyan NB_UID=1000 HOME=/home/jovyan PIP_NO_CACHE_DIR=1
RUN useradd --create-home --uid 1000 jovyan

# PyTorch's build for processors: without CUDA's libraries it is gigabytes smaller
RUN pip install torch==2.13.0 --index-url https://download.pytorch.org/whl/cpu
COPY --chown=jovyan . /home/jovyan/uavdh_lite
WORKDIR /home/jovyan/uavdh_lite
RUN pip install ".[classroom]"

USER jovyan
WORKDIR /home/jovyan/uavdh_lite/notebooks
EXPOSE 8888
CMD ["jupyter", "lab", "--ip=0.0.0.0", "--no-browser"]
