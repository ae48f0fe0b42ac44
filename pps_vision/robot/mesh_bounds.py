"""`python mesh_bounds.py FILE…`: print the bounding box of each mesh, [[low], [high]], a line each.

It is a separate process because readers of meshes may hang or crash.
"""

import json
import resource
import sys

import coal

_MOST_MEMORY = 2**32  # bytes

if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_AS, (_MOST_MEMORY, _MOST_MEMORY))
    for file in sys.argv[1:]:
        mesh = coal.MeshLoader().load(file)
        mesh.computeLocalAABB()
        print(json.dumps([mesh.aabb_local.min_.tolist(), mesh.aabb_local.max_.tolist()]), flush=True)
