"""A 3D path that turns under the mouse, as an HTML fragment with its own script; distance and time to contact of it."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

from pps_vision.app.report.page import fragment
from pps_vision.recordings.tables import CHI2_95
from pps_vision.types import Array

if TYPE_CHECKING:  # tracking alone needs no robot
    from pps_vision.robot.model import Posture

_MOST_POINTS = 4000  # in a line; every k-th of a longer one is drawn
_MOST_ELLIPSOIDS = 40
_SLOWEST_M_S = 0.01  # slower approaches have no time to contact

PATH_SCRIPT = """
(function(){
const data=JSON.parse(document.getElementById("path-data").textContent),canvas=document.getElementById("path");
const c=canvas.getContext("2d");let yaw=0.6,pitch=0.5,zoom=1,drag=null;
function turn(p){const a=Math.cos(yaw),b=Math.sin(yaw),e=Math.cos(pitch),f=Math.sin(pitch);
const x=a*p[0]-b*p[1],y=b*p[0]+a*p[1];return [x,-(e*p[2]-f*y)];}
function draw(){
const w=canvas.width,h=canvas.height,s=zoom*0.42*Math.min(w,h)/data.size;
const at=p=>{
const q=turn([p[0]-data.center[0],p[1]-data.center[1],p[2]-data.center[2]]);return [w/2+s*q[0],h/2+s*q[1]];};
c.clearRect(0,0,w,h);c.font="14px system-ui";
for(const axis of data.axes){const a=at(axis.from),b=at(axis.to);c.strokeStyle=axis.color;c.lineWidth=1;
c.beginPath();c.moveTo(a[0],a[1]);c.lineTo(b[0],b[1]);c.stroke();c.fillStyle=axis.color;c.fillText(axis.name,b[0]+4,b[1]);}
c.strokeStyle="rgba(70,120,200,0.35)";
for(const e of data.ellipsoids){const o=at(e.at),v=e.axes.map(turn);
const xx=v.reduce((t,q)=>t+q[0]*q[0],0),xy=v.reduce((t,q)=>t+q[0]*q[1],0),yy=v.reduce((t,q)=>t+q[1]*q[1],0);
const m=(xx+yy)/2,d=Math.hypot((xx-yy)/2,xy),angle=0.5*Math.atan2(2*xy,xx-yy);
c.beginPath();c.ellipse(o[0],o[1],s*Math.sqrt(m+d),s*Math.sqrt(Math.max(m-d,0)),angle,0,7);c.stroke();}
for(const line of data.lines){c.strokeStyle=line.color;c.lineWidth=line.width;c.beginPath();let down=false;
for(const p of line.points){if(p===null){down=false;continue;}const q=at(p);
if(down)c.lineTo(q[0],q[1]);else c.moveTo(q[0],q[1]);down=true;}c.stroke();}
}
let across=1e-9,up=1e-9;
for(const line of [...data.lines,{points:data.axes.map(a=>a.to)}])for(const p of line.points)if(p){
const q=turn([p[0]-data.center[0],p[1]-data.center[1],p[2]-data.center[2]]);
across=Math.max(across,Math.abs(q[0]));up=Math.max(up,Math.abs(q[1]));}
zoom=0.95*data.size*Math.min(canvas.width/across,canvas.height/up)/Math.min(canvas.width,canvas.height);
canvas.addEventListener("pointerdown",e=>{drag=[e.clientX,e.clientY];canvas.setPointerCapture(e.pointerId);});
canvas.addEventListener("pointermove",e=>{if(!drag)return;yaw+=(e.clientX-drag[0])/150;pitch+=(e.clientY-drag[1])/150;
drag=[e.clientX,e.clientY];draw();});
canvas.addEventListener("pointerup",()=>{drag=null;});
canvas.addEventListener("wheel",e=>{e.preventDefault();zoom*=Math.exp(-e.deltaY/600);draw();},{passive:false});
draw();})();
"""


def path3d(lines: Sequence[tuple[str, Array]], at: Array, cov: Array, thick: int = 1) -> Markup:
    """Return one line or more (color, points (n ≥ 1, 3) in m; NaN is a gap; the first `thick` are drawn thicker) and
    the 95 % ellipsoids of positions `at` (m, 3) with covariances (m, 3, 3) in m², as HTML."""
    shown = [(color, points[:: -(-len(points) // _MOST_POINTS)]) for color, points in lines]
    finite = np.concatenate([points[np.isfinite(points).all(axis=1)] for _, points in shown])
    if not len(finite):
        return Markup("<p>No position is known.</p>")
    low = finite.min(axis=0)
    high = finite.max(axis=0)
    size = max(float(np.linalg.norm(high - low)) / 2, 1e-3)
    chosen = np.unique(np.linspace(0, len(at) - 1, _MOST_ELLIPSOIDS).astype(int)) if len(at) else np.empty(0, int)
    step = 10.0 ** np.floor(np.log10(size))
    data = {
        "center": ((low + high) / 2).tolist(),
        "size": size,
        "axes": [
            {"name": f"{name} +{step:g} m", "color": color, "from": low.tolist(), "to": (low + step * axis).tolist()}
            for name, color, axis in zip("xyz", ("#c33", "#393", "#33c"), np.eye(3), strict=True)
        ],
        "lines": [
            {
                "color": color,
                "width": 2.5 if k < thick else 1,
                "points": [point.tolist() if np.isfinite(point).all() else None for point in points],
            }
            for k, (color, points) in enumerate(shown)
        ],
        "ellipsoids": [
            {"at": at[k].tolist(), "axes": (rotation * lengths).T.tolist()}
            for k, (lengths, rotation) in ((k, ellipsoid_95(cov[k])) for k in chosen)
        ],
    }
    return fragment(
        '<canvas id="path" width="900" height="560" style="width:100%;touch-action:none;cursor:grab"></canvas>'
        '<script type="application/json" id="path-data">{{ data|tojson }}</script><script>{{ script }}</script>',
        data=data,
        script=Markup(PATH_SCRIPT),
    )


def body_lines(posture: "Posture") -> Array:
    """Return the edges of a robot's bodies as lines for `path3d`: (n, 3) in the root frame, NaN between lines."""
    angle = np.linspace(0, 2 * np.pi, 13)
    circle = np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
    lines: list[Array] = []
    for body in posture.robot.bodies:
        if body.shape == "sphere":
            edges = [body.size_m[0] * circle[:, order] for order in ([0, 1, 2], [0, 2, 1], [2, 0, 1])]
        elif body.shape == "cylinder":
            radius, length = body.size_m
            ends = [radius * circle + [0, 0, end * length / 2] for end in (-1, 1)]
            edges = [*ends, *np.stack(ends, axis=1)[:-1:3]]
        else:
            square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [-1, -1, 0]])
            sides = [0.5 * np.array(body.size_m) * (square + np.array([0, 0, end])) for end in (-1, 1)]
            edges = [*sides, *np.stack(sides, axis=1)[:-1]]
        T = posture.T_root(body.frame) @ body.T_frame_body
        for edge in edges:
            lines += [edge @ T[:3, :3].T + T[:3, 3], np.full((1, 3), np.nan)]
    return np.concatenate(lines)


def ellipsoid_95(cov: Array) -> tuple[Array, Array]:
    """Half axes (3,) in m of the ellipsoid that holds 95 %, and the rotation (3, 3) whose columns they lie along, of a
    covariance (3, 3) in m²."""
    values, vectors = np.linalg.eigh(cov)
    vectors[:, 0] *= np.sign(np.linalg.det(vectors))  # no reflection
    return np.sqrt(CHI2_95 * np.clip(values, 0, None)), vectors


def distance_and_ttc_of_origin(position: Array, velocity: Array) -> tuple[Array, Array]:
    """Distance (…) in m from the root frame's origin, and the time (…) in s until the object at `position` would be
    there at its present speed of approach, from its `velocity`, both (…, 3); NaN where it does not approach."""
    distance = np.linalg.norm(position, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        closing = -np.sum(position * velocity, axis=-1) / distance
        return distance, np.where(closing > _SLOWEST_M_S, distance / closing, np.nan)
