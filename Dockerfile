# The course for a JupyterHub and for Binder: notebooks and package, but no solutions
#   docker build -t uavdh_lite-students . && docker run --rm -p 8888:8888 uavdh_lite-students
# For teachers, with all of it: docker build -t uavdh_lite-teachers --target teachers .
FROM python:3.11-slim AS base

# JupyterHub and Binder start it as this user, in its home
ENV NB_USER=jovyan NB_UID=1000 HOME=/home/jovyan PIP_NO_CACHE_DIR=1
RUN useradd --create-home --uid 1000 jovyan

# PyTorch's build for processors: without CUDA's libraries it is gigabytes smaller
RUN pip install torch==2.13.0 --index-url https://download.pytorch.org/whl/cpu
WORKDIR /home/jovyan/course
EXPOSE 8888
CMD ["jupyter", "lab", "--ip=0.0.0.0", "--no-browser"]

FROM base AS teachers
COPY --chown=jovyan . .
RUN pip install ".[classroom]"
USER jovyan
WORKDIR /home/jovyan/course/notebooks

FROM base AS handout
COPY . .
RUN python notebooks/handout.py /handout

# The last one is what is built if none is named
FROM base AS students
COPY --from=handout --chown=jovyan /handout .
RUN pip install "$(ls /home/jovyan/course/*.whl)[notebooks]"
USER jovyan
WORKDIR /home/jovyan/course/notebooks
