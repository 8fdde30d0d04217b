#!/usr/bin/env bash
# Builds targets as a CI job does, and checks the bounds of their recipes: cache/ci/build.sh twin/laptop_scene
#
#   DXB_CACHE       the store, a folder that the CI keeps from job to job or begins anew
#   TWIN_REMOTE     a remote by name or address; none: the store alone
#   TWIN_WRITE      `true`: also upload results to the remote; for the main branch
#   TWIN_LOCKED     `true`: exit with 3 where a target is not what dxb.lock says; for pull requests
#   TWIN_STORE_MAX  maximal size of the store after the job, 5GB
set -euo pipefail

stores=local:rw
if [[ -n "${TWIN_REMOTE:-}" ]]; then
  mode=r
  [[ "${TWIN_WRITE:-}" == true ]] && mode=rw
  stores="local:rw,$TWIN_REMOTE:$mode"
fi
flags=()
[[ "${TWIN_LOCKED:-}" == true ]] && flags=(--locked)

code=0
dxb build "$@" --console plain --keep-going --cache "$stores" "${flags[@]}" || code=$?
# Bounds that recipes state for their results, `expect:`; profile stub makes stand-ins, for which none is meant.
for target in "$@"; do
  if [[ "$code" == 0 && "$target" != *:* ]]; then
    dxb check "$target" || code=$?
  fi
done
# What this job built or took stays; what only older ones used goes, so that the store does not grow from job to job.
dxb cache gc --max-size "${TWIN_STORE_MAX:-5GB}" --yes >&2
exit "$code"
