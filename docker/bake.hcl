# The image for amd64 and arm64, with a list of its contents and how it was made:
#   export PYTHON_IMAGE=python:3.13-slim@sha256:…   # the digest of the index, of all architectures
#   docker buildx bake -f docker/bake.hcl                      # builds both, keeps them in the cache
#   IMAGE=registry.example.org/vibroimpact docker buildx bake -f docker/bake.hcl --push
# For this machine alone:  docker buildx bake -f docker/bake.hcl --load --set '*.platform=local'
# Kernels of the other architecture are compiled by QEMU, if no builder has it:
#   docker run --privileged --rm tonistiigi/binfmt --install arm64
variable "PYTHON_IMAGE" {
  validation {
    condition = length(regexall("@sha256:[0-9a-f]{64}$", PYTHON_IMAGE)) == 1
    error_message = "PYTHON_IMAGE must name a digest: python:3.13-slim@sha256:…"
  }
}

variable "IMAGE" {
  default = "vibroimpact"
}

variable "VERSION" {
  default = "0.2.0"
}

# What the image says of its sources:  export REVISION=$(git rev-parse HEAD)
variable "REVISION" {
  default = "unknown"
}

group "default" {
  targets = ["image"]
}

target "image" {
  context = "."
  dockerfile = "docker/Dockerfile"
  args = {
    PYTHON_IMAGE = PYTHON_IMAGE
    VERSION = VERSION
    REVISION = REVISION
  }
  platforms = ["linux/amd64", "linux/arm64"]
  tags = ["${IMAGE}:${VERSION}", "${IMAGE}:latest"]
  attest = ["type=sbom", "type=provenance,mode=max"]
}
