# SPDX-License-Identifier: MIT
# physim-drake on the command line; `make docker` builds and tries it.
#
#   docker run --rm -v $PWD:/data -w /data physim-drake estimate DATASET --out results.csv
FROM python:3.11-slim-bookworm

COPY requirements/system_libraries.sh /tmp/
RUN /tmp/system_libraries.sh && rm -rf /var/lib/apt/lists/*

COPY . /src
RUN pip install --no-cache-dir "/src[viz]" && rm -rf /src

ENTRYPOINT ["physim-drake"]
CMD ["--help"]
