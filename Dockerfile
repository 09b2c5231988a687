# A container with everything, as `make venv` installs it: docker build -t echolearn . ; docker run echolearn --help
# Nobody has built it yet where this was written, for want of a container engine.
FROM python:3.11-slim-bookworm

RUN apt-get update \
    && apt-get install --yes --no-install-recommends git make \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /echolearn
COPY . .
RUN make venv
ENV PATH=/echolearn/.venv/bin:$PATH

# Results stay on the machine: docker run -v "$PWD/runs:/echolearn/runs" echolearn map survey=examples/survey/short
ENTRYPOINT ["echolearn"]
CMD ["--help"]
