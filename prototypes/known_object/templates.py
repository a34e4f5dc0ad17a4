"""Prototype: templates of a textured mesh, search over rotations."""
import json, time, sys
from pathlib import Path
import numpy as np, cv2, trimesh
from PIL import Image
from vig_native import engine
H = Path('hope')

def srgb_lin(x): return np.where(x <= .04045, x/12.92, ((x+.055)/1.055)**2.4).astype(np.float32)
LUT = srgb_lin(np.arange(256)/255.)

def load(name, plain=False):
    p = H/f'meshes/{name}_other.glb'
    if not p.exists(): p = H/f'meshes/{name}.glb'
    s = trimesh.load(p, process=False)
    m = s.to_geometry() if hasattr(s, 'to_geometry') else s
    vis = m.visual
    mat = vis.material
    img = getattr(mat, 'baseColorTexture', None) or getattr(mat, 'image', None)
    tex = np.array(img.convert('RGB'))
    uv = np.array(vis.uv, np.float32)
    V=np.array(m.vertices,np.float64); F=np.array(m.faces,np.int32)
    _,first,inv=np.unique(np.round(np.concatenate([V,uv],1),6),axis=0,return_index=True,return_inverse=True)
    return V[first], inv.ravel()[F].astype(np.int32), uv[first], tex, p

def sphere(n):
    i = np.arange(n)+.5
    z = 1-2*i/n; phi = np.pi*(1+5**.5)*i
    r = np.sqrt(1-z*z)
    return np.stack([r*np.cos(phi), r*np.sin(phi), z], 1)

def look(d):
    """camera_from_object rotation whose -z axis (towards the eye) is d."""
    zc = -d
    up = np.array([0,0,1.]) if abs(d[2])<.99 else np.array([0,1.,0])
    x = np.cross(zc, up); x/=np.linalg.norm(x)   # right: y down = z cross x
    y = np.cross(zc, x)
    return np.stack([x,y,zc])

class Templates:
    def __init__(self, V, F, uv, tex, n=500, size=32, ss=4):
        t0=time.time()
        self.V, self.F = V, F
        self.centre = (V.max(0)+V.min(0))/2
        self.radius = np.linalg.norm(V-self.centre, axis=1).max()
        P = (V-self.centre)/self.radius
        self.dirs = sphere(n); self.rot = np.stack([look(d) for d in self.dirs])
        D = 6.0; S=size*ss
        f = S/2*np.sqrt(D*D-1)*.98
        self.size=size
        small = cv2.resize(tex, None, fx=min(1,384/max(tex.shape)), fy=min(1,384/max(tex.shape)), interpolation=cv2.INTER_AREA)
        lin = LUT[small]
        fn = np.cross(P[F[:,1]]-P[F[:,0]], P[F[:,2]]-P[F[:,0]])
        vn = np.zeros_like(P)
        for k in range(3): np.add.at(vn, F[:,k], fn)
        # merge by position for smooth normals
        _, inv = np.unique(np.round(P,5), axis=0, return_inverse=True); inv=inv.ravel()
        acc = np.zeros((inv.max()+1,3)); np.add.at(acc, inv, vn); vn = acc[inv]
        vn /= np.linalg.norm(vn,axis=1,keepdims=True)+1e-12
        mask=[];col=[];nor=[]
        h,w = lin.shape[:2]
        for R in self.rot:
            C = P@R.T + [0,0,D]
            face, bary = raster(C, F, f, S)
            hit = face>=0
            fc = F[face[hit]]; b = bary[hit]
            q = (b[...,None]*uv[fc]).sum(1)
            c = np.zeros((S,S,3),np.float32)
            x = (q[:,0]%1)*w-.5; y = (1-q[:,1]%1)*h-.5
            c[hit] = cv2.remap(lin, x.astype(np.float32)[None], y.astype(np.float32)[None], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[0]
            nn = np.zeros((S,S,3),np.float32); nn[hit] = ((b[...,None]*vn[fc]).sum(1))@R.T
            m = hit.reshape(size,ss,size,ss).mean((1,3)).astype(np.float32)
            av = lambda a: a.reshape(size,ss,size,ss,3).mean((1,3))/np.maximum(m,1e-6)[...,None]
            mask.append(m); col.append(av(c)); nor.append(av(nn))
        self.mask=np.stack(mask); self.col=np.stack(col).astype(np.float32); self.nor=np.stack(nor).astype(np.float32)
        self.scale = f/D/ss   # template pixels per unit radius at centre depth
        self.seconds=time.time()-t0

def raster(C, F, f, S):
    out = engine.rasterize(np.ascontiguousarray(C, np.float32), F, (f, S/2, S/2, S, S), .01, False)
    return out[0], out[1]
