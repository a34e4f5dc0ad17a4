from templates import *
def rodr(a,b):
    """rotation taking unit a to b"""
    v=np.cross(a,b); c=a@b
    K=np.array([[0,-v[2],v[1]],[v[2],0,-v[0]],[-v[1],v[0],0]])
    return np.eye(3)+K+K@K/(1+c)

def prepare(T, K_in=36):
    P=(T.V-T.centre)/T.radius
    hull=trimesh.convex.convex_hull(P).vertices
    if len(hull)>400: hull=hull[np.random.default_rng(0).permutation(len(hull))[:400]]
    D=6.0
    C=np.einsum('nij,vj->nvi',T.rot,hull); z=C[...,2]+D
    xy=C[...,:2]/z[...,None]*D*T.scale  # template px
    ang=np.arange(K_in)*2*np.pi/K_in
    R=np.stack([np.stack([np.cos(ang),-np.sin(ang)],-1),np.stack([np.sin(ang),np.cos(ang)],-1)],1) # a,2,2
    q=np.einsum('aij,nvj->anvi',R,xy)
    T.lo=q.min(2); T.hi=q.max(2)   # a,n,2
    T.ang=ang; T.R2=R

def candidates(T, box, tol=.35):
    x0,x1,y0,y1=box; W,Hh=x1-x0,y1-y0
    w=(T.hi-T.lo)[...,0]; h=(T.hi-T.lo)[...,1]
    s=np.sqrt((W*Hh)/(w*h))
    asp=np.log(W/Hh)-np.log(w/h)
    a,n=np.nonzero(np.abs(asp)<tol)
    return a,n,s[a,n],asp[a,n]

def grid(T): 
    g=np.arange(T.size)+.5-T.size/2
    return np.stack(np.meshgrid(g,g),-1).reshape(-1,2)

def score(T, lin, vis, box, a, n, s, shading=True, chunk=1024, sil=1.0, detail=False):
    """lin: (H,W,3) linear photo crop blurred; vis (H,W) float visible mask. box in crop coordinates."""
    g=grid(T); D=T.size**2
    c=np.array([(box[0]+box[1])/2,(box[2]+box[3])/2])
    mid=(T.lo[a,n]+T.hi[a,n])/2
    out=np.empty(len(a)); 
    nvis=float(vis.sum())
    for i in range(0,len(a),chunk):
        aa,nn,ss=a[i:i+chunk],n[i:i+chunk],s[i:i+chunk]
        q=np.einsum('kij,dj->kdi',T.R2[aa],g)-mid[i:i+chunk][:,None]
        xy=(c+ss[:,None,None]*q).astype(np.float32)
        m1,m2=xy[...,0],xy[...,1]
        col=cv2.remap(lin,m1,m2,cv2.INTER_LINEAR,borderMode=cv2.BORDER_CONSTANT)
        v=cv2.remap(vis,m1,m2,cv2.INTER_LINEAR,borderMode=cv2.BORDER_CONSTANT)
        M=T.mask[nn].reshape(len(nn),D); t=T.col[nn].reshape(len(nn),D,3)
        w=M*v; W=w.sum(1)+1e-6
        inside=W; 
        outside=nvis/ss**2-inside        # visible pixels outside the template
        miss=M.sum(1)-inside             # template pixels not visible
        tot=0
        if shading:
            nr=T.nor[nn].reshape(len(nn),D,3)
            B=np.concatenate([np.ones_like(M)[...,None],nr],-1)
        else: B=np.ones_like(M)[...,None]
        for ch in range(3):
            X=B*t[...,ch:ch+1]; y=col[...,ch]
            A=np.einsum('kd,kdi,kdj->kij',w,X,X,optimize=True); b=np.einsum('kd,kdi,kd->ki',w,X,y,optimize=True)
            tr=A[:,0,0][:,None]
            ridge=np.eye(B.shape[-1])[None]*tr[...,None]*np.array([1e-6]+[.05]*(B.shape[-1]-1))
            co=np.linalg.solve(A+ridge,b[...,None])[...,0]
            yy=(w*y*y).sum(1)
            sse=yy-2*(co*b).sum(1)+np.einsum('ki,kij,kj->k',co,A,co)
            sst=yy-(w*y).sum(1)**2/W
            tot=tot+np.log((sse+1e-4*W)/W)
        J=inside/(inside+np.maximum(outside,0)+.5*miss)
        out[i:i+chunk]=-.5*tot+ sil*4*np.log(J+1e-3)
    return out

def angle(R,S): return np.degrees(np.arccos(np.clip((np.trace(R@S.T)-1)/2,-1,1)))

class Photo:
    cache={}
    def __init__(s,entry,photo):
        s.e=entry; s.p=photo
def objects(light,least=.3):
    for path in sorted(H.glob(f'photos/*/{light:04d}.json')):
        d=json.loads(path.read_text())
        for e in d['objects']:
            if e['visible_fraction']>=least and e['in_photo_fraction']>=.9: yield e['name'],path,d,e

def crop(d,e,size,usemask=True,blur=1.0):
    """photo crop where the amodal box's larger side is about `size` px*1.0; returns lin, vis, box, K"""
    im=np.array(Image.open(H/d['photo']).convert('RGB')); m=np.array(Image.open(H/e['mask_visible']).convert('L'))>0
    x0,y0,bw_,bh_=e['box_whole_unclipped']; x1,y1=x0+bw_,y0+bh_; L=max(x1-x0,y1-y0)
    f=size/L
    pad=.25*L
    X0,Y0=int(np.floor(x0-pad)),int(np.floor(y0-pad)); X1,Y1=int(np.ceil(x1+pad)),int(np.ceil(y1+pad))
    cv=np.zeros((Y1-Y0,X1-X0,3),np.float32); mv=np.zeros((Y1-Y0,X1-X0),np.float32)
    a,b=max(X0,0),max(Y0,0); c_,d_=min(X1,im.shape[1]),min(Y1,im.shape[0])
    cv[b-Y0:d_-Y0,a-X0:c_-X0]=LUT[im[b:d_,a:c_]]; mv[b-Y0:d_-Y0,a-X0:c_-X0]=m[b:d_,a:c_] if usemask else 1
    w,h=round(cv.shape[1]*f),round(cv.shape[0]*f)
    fx,fy=w/cv.shape[1],h/cv.shape[0]
    sm=cv2.resize(cv*mv[...,None],(w,h),interpolation=cv2.INTER_AREA); vm=cv2.resize(mv,(w,h),interpolation=cv2.INTER_AREA)
    lin=sm/np.maximum(vm,1e-3)[...,None]
    # shift: pixel-centre coordinates for remap
    bx=[(x0-X0)*fx-.5,(x1-X0)*fx-.5,(y0-Y0)*fy-.5,(y1-Y0)*fy-.5]
    return lin,vm,bx

def ray_rotation(d,e):
    K=np.array(d['K']); x0,y0,bw_,bh_=e['box_whole_unclipped']; x1,y1=x0+bw_,y0+bh_
    r=np.linalg.inv(K)@[(x0+x1)/2,(y0+y1)/2,1]; r/=np.linalg.norm(r)
    return rodr(np.array([0,0,1.]),r)
import ctypes
L=ctypes.CDLL('./view_score.so')
P_=lambda a:a.ctypes.data_as(ctypes.c_void_p)
def pack(T):
    n=len(T.rot);D=T.size
    T.planes=np.ascontiguousarray(np.concatenate([T.mask[:,None],T.col.transpose(0,3,1,2),T.nor.transpose(0,3,1,2)],1),np.float32)
def nscore(T,lin,vis,box,a,n,s,sil=4.0,shading=1,angles=None):
    c=np.array([(box[0]+box[1])/2,(box[2]+box[3])/2])
    mid=(T.lo[a,n]+T.hi[a,n])/2
    th=T.ang[a]
    tr=np.stack([s*np.cos(th),s*np.sin(th),c[0]-s*mid[:,0],c[1]-s*mid[:,1],s],1).astype(np.float32)
    ph=np.ascontiguousarray(np.concatenate([lin.transpose(2,0,1),vis[None]]),np.float32)
    out=np.empty(len(a)); view=n.astype(np.int32)
    L.score(P_(T.planes),T.size,P_(ph),ph.shape[1],ph.shape[2],P_(view),P_(tr),len(a),ctypes.c_float(float(vis.sum())),ctypes.c_float(sil),shading,P_(out))
    return out
