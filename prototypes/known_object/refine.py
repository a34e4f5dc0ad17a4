from search import *
from scipy.optimize import minimize
LR=ctypes.CDLL('./pose_score.so'); LR.pose_score.restype=ctypes.c_double
class CMesh(ctypes.Structure): _fields_=[(n,ctypes.c_void_p) for n in ('P','F','uv','vn','tex')]+[(n,ctypes.c_int) for n in ('nv','nf','tw','th')]
def cmesh(T,V,F,uv,tex,texmax=512):
    P=np.ascontiguousarray(V-T.centre,np.float32)
    s=min(1,texmax/max(tex.shape)); tx=np.ascontiguousarray(LUT[cv2.resize(tex,None,fx=s,fy=s,interpolation=cv2.INTER_AREA)])
    fn=np.cross(P[F[:,1]]-P[F[:,0]],P[F[:,2]]-P[F[:,0]]); vn=np.zeros_like(P)
    _,inv=np.unique(np.round(P,6),axis=0,return_inverse=True); inv=inv.ravel(); acc=np.zeros((inv.max()+1,3))
    for k in range(3): np.add.at(acc,inv[F[:,k]],fn)
    vn=acc[inv]; vn=np.ascontiguousarray(vn/(np.linalg.norm(vn,axis=1,keepdims=True)+1e-12),np.float32)
    F=np.ascontiguousarray(F,np.int32); uv=np.ascontiguousarray(uv,np.float32)
    T.keep=(P,F,uv,vn,tx); T.cm=CMesh(*[a.ctypes.data for a in T.keep],len(P),len(F),tx.shape[1],tx.shape[0])
def rv(w):
    a=np.linalg.norm(w)
    if a<1e-12: return np.eye(3)
    k=w/a; K=np.array([[0,-k[2],k[1]],[k[2],0,-k[0]],[-k[1],k[0],0]])
    return np.eye(3)+np.sin(a)*K+(1-np.cos(a))*K@K
class Crop:
    def __init__(s,d,e,size,usemask=True):
        im=np.array(Image.open(H/d['photo']).convert('RGB')); m=np.array(Image.open(H/e['mask_visible']).convert('L'))>0
        x0,y0,bw,bh=e['box_whole_unclipped']; L=max(bw,bh); f=size/L; pad=.15*L
        X0,Y0=x0-pad,y0-pad; w,h=int(np.ceil((bw+2*pad)*f)),int(np.ceil((bh+2*pad)*f))
        lin=LUT[im]; mv=(m if usemask else np.ones_like(m)).astype(np.float32)
        inside=np.ones_like(mv)
        # area resample by affine with prior blur
        k=max(1,int(round(1/f)))
        M=np.array([[f,0,-X0*f],[0,f,-Y0*f]])
        # supersample: warp at 4x then average
        S=4 if f<1 else 2
        Ms=M.copy()*S; Ms[:,2]+= .5*S*f-.5
        wl=cv2.warpAffine(lin*mv[...,None],Ms,(w*S,h*S),flags=cv2.INTER_LINEAR); wm=cv2.warpAffine(mv,Ms,(w*S,h*S),flags=cv2.INTER_LINEAR)
        sl=wl.reshape(h,S,w,S,3).mean((1,3)); sm=wm.reshape(h,S,w,S).mean((1,3))
        s.lin=sl/np.maximum(sm,1e-3)[...,None]; s.vis=sm
        s.ph=np.ascontiguousarray(np.concatenate([s.lin.transpose(2,0,1),s.vis[None]]),np.float32)
        K=np.array(d['K']); s.fx,s.fy=K[0,0]*f,K[1,1]*f; s.cx,s.cy=(K[0,2]-X0)*f,(K[1,2]-Y0)*f
        s.box=np.array([(x0-X0)*f,(x0+bw-X0)*f,(y0-Y0)*f,(y0+bh-Y0)*f],np.float32); s.L=size; s.h,s.w=h,w
        s.nvis=float(sm.sum())
    def score(s,T,R,t,ss=2,box=True,sil=4.,app=1.,dbg=None,bs=.02,sigma=.15,alpha=.8):
        R=np.ascontiguousarray(R,np.float32); t=np.ascontiguousarray(t,np.float32)
        F=ctypes.c_float
        return LR.pose_score(ctypes.byref(T.cm),P_(R),P_(t),F(s.fx),F(s.fy),F(s.cx),F(s.cy),P_(s.ph),s.h,s.w,ss,F(s.nvis),P_(s.box) if box else None,F(bs*s.L),F(sil),F(app),F(sigma),F(alpha),P_(dbg) if dbg is not None else None)
def pose_of_box(T,c,R,iters=4):
    """translation such that the projected bbox has centre and area of the box"""
    P=T.keep[0]; Q=P@R.T.astype(np.float32); b=c.box
    z=T.radius*2*c.fx/max(b[1]-b[0],b[3]-b[2]); t=np.array([((b[0]+b[1])/2-c.cx)/c.fx*z,((b[2]+b[3])/2-c.cy)/c.fy*z,z])
    for _ in range(iters):
        C=Q+t; u=c.fx*C[:,0]/C[:,2]+c.cx; v=c.fy*C[:,1]/C[:,2]+c.cy
        g=np.sqrt(((u.max()-u.min())*(v.max()-v.min()))/((b[1]-b[0])*(b[3]-b[2])))
        z=t[2]*g
        du=(b[0]+b[1])/2-(u.max()+u.min())/2; dv=(b[2]+b[3])/2-(v.max()+v.min())/2
        t=np.array([t[0]*g+du*z/c.fx,t[1]*g+dv*z/c.fy,z])
    return t
def refine(T,c,R0,t0,evals=100,step=(.14,.02,.03),**kw):
    def pose(x):
        z=t0[2]*np.exp(x[5]*step[2]); 
        t=np.array([(t0[0]/t0[2]+x[3]*step[1]*c.L/c.fx)*z,(t0[1]/t0[2]+x[4]*step[1]*c.L/c.fy)*z,z])
        return rv(x[:3]*step[0])@R0,t
    f=lambda x:-c.score(T,*pose(x),**kw)
    sim=np.concatenate([np.zeros((1,6)),np.eye(6)])
    r=minimize(f,np.zeros(6),method='Nelder-Mead',options=dict(maxfev=evals,initial_simplex=sim,xatol=1e-3,fatol=1e-3,adaptive=True))
    return -r.fun,*pose(r.x)
