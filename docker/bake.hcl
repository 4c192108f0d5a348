# The image for amd64 and arm64, with a list of its contents and how it was made:
#   docker buildx bake -f docker/bake.hcl                      # builds both, keeps them in the cache
#   export PYTHON_IMAGE=python:3.13-slim@sha256:…   # pins the base: the digest of the index, of all
#   IMAGE=registry.example.org/vibroimpact docker buildx bake -f docker/bake.hcl --push
# For this machine alone:  docker buildx bake -f docker/bake.hcl --load --set '*.platform=local'
# Kernels of the other architecture are compiled by QEMU, if no builder has it:
#   docker run --privileged --rm tonistiigi/binfmt --install arm64
variable "PYTHON_IMAGE" {
  default = "python:3.13-slim"
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
