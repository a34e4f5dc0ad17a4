from refine import *
from scipy.spatial import cKDTree
import argparse
ap=argparse.ArgumentParser(); ap.add_argument('--light',type=int,default=0); ap.add_argument('--app',type=float,default=1); ap.add_argument('--sil',type=float,default=4); ap.add_argument('--every',type=int,default=1);ap.add_argument('--off',type=int,default=0);ap.add_argument('--neff',type=float,default=20);ap.add_argument('--sg',type=float,default=.2);ap.add_argument('--sk',type=float,default=.5);ap.add_argument('--apart',type=float,default=22); ap.add_argument('--picks',type=int,default=8);ap.add_argument('--sigma',type=float,default=.15);ap.add_argument('--alpha',type=float,default=.8);ap.add_argument('--kinds',nargs='*'); ap.add_argument('--nomask',action='store_true'); ap.add_argument('--n',type=int,default=400)
A=ap.parse_args()
TT={};rows=[];fails=[]
objs=sorted(objects(A.light),key=lambda r:r[0])[A.off::A.every]
LR.setp.argtypes=[ctypes.c_double]*3; LR.setp(A.neff,A.sg,A.sk)
for name,path,d,e in objs:
    if A.kinds and name not in A.kinds: continue
    if name not in TT:
        m=load(name)[:4]; T=TT[name]=Templates(*m,n=A.n,size=24); prepare(T,36); pack(T); cmesh(T,*m)
    T=TT[name]
    t0=time.time()
    lin,vm,bx=crop(d,e,24,usemask=not A.nomask); a,nn,s,asp=candidates(T,bx)
    sc=nscore(T,lin,vm,bx,a,nn,s)-8*asp**2
    Rr=ray_rotation(d,e); ca,sa=np.cos(T.ang),np.sin(T.ang); Rz=np.zeros((len(ca),3,3)); Rz[:,0,0]=ca;Rz[:,0,1]=-sa;Rz[:,1,0]=sa;Rz[:,1,1]=ca;Rz[:,2,2]=1
    order=np.argsort(-sc)[:1500]; Rc=Rr@Rz[a[order]]@T.rot[nn[order]]
    picks=[]
    for k in range(len(order)):
        if not picks or all(np.trace(Rc[k]@Rc[j].T)<1+2*np.cos(np.radians(A.apart)) for j in picks): picks.append(k)
        if len(picks)>=A.picks: break
    t1=time.time()
    c=Crop(d,e,48,usemask=not A.nomask); kw=dict(app=A.app,sil=A.sil,sigma=A.sigma,alpha=A.alpha)
    res=[refine(T,c,Rc[k],pose_of_box(T,c,Rc[k]),70,**kw) for k in picks]
    res.sort(key=lambda r:-r[0])
    c2=Crop(d,e,80,usemask=not A.nomask)
    res2=[refine(T,c2,r[1],r[2],110,step=(.06,.008,.012),**kw) for r in res[:3]]
    res2.sort(key=lambda r:-r[0])
    t2=time.time()
    TR=np.array(e['camera_from_object']); best=res2[0]
    # object frame: mesh coordinates minus centre
    Rt=TR[:3,:3]; tt=Rt@T.centre+TR[:3,3]
    st=refine(T,c2,Rt,tt,60,step=(.02,.003,.004),**kw)
    idx=np.random.default_rng(0).integers(len(T.V),size=1500); Pp=T.keep[0][idx]; Pm=Pp@best[1].T+best[2]; Pt=Pp@Rt.T+tt
    diam=np.linalg.norm(T.V.max(0)-T.V.min(0)); add=np.linalg.norm(Pm-Pt,axis=1).mean()/diam; adds=cKDTree(Pm).query(Pt)[0].mean()/diam
    if angle(best[1],Rt)>15:
        tiles=[c2.lin*np.minimum(1,.3+c2.vis[...,None])]
        for (R_,t_) in ((best[1],best[2]),(Rt,tt)):
            D=np.zeros((4,c2.h,c2.w),np.float32); c2.score(T,R_,t_,dbg=D); tiles.append(D[:3].transpose(1,2,0))
        im=np.concatenate([np.pad(t_/max(np.percentile(t_,99),1e-3),((0,120-c2.h if c2.h<120 else 0),(0,120-c2.w if c2.w<120 else 0),(0,0)))[:120,:120] for t_ in tiles],1)
        fails.append(im)
    rows.append((name,e['visible_fraction'],add,adds,angle(best[1],Rt),best[0],st[0],best[2][2]/tt[2]-1,res2[1][0] if len(res2)>1 else -9,t1-t0,t2-t1))
    print('%-18s vis %.2f add %.3f adds %.3f ang %5.1f score %.2f true %.2f z %+.3f second %.2f  %.1f %.1fs'%rows[-1],flush=True)
R=np.array([r[1:] for r in rows])
for lo,hi in ((.3,.6),(.6,.9),(.9,1.01),(0,1.01)):
    k=(R[:,0]>=lo)&(R[:,0]<hi)
    if k.any(): print('%.1f n %d add %.2f adds %.2f ang15 %.2f | true better: %.2f'%(lo,k.sum(),(R[k,1]<.1).mean(),(R[k,2]<.1).mean(),(R[k,3]<15).mean(),((R[k,5]>R[k,4]+.02)&(R[k,3]>15)).mean()))

if fails:
    cols=3; fails+= [np.zeros_like(fails[0])]*(-len(fails)%cols)
    sheet=np.concatenate([np.concatenate(fails[i:i+cols],1) for i in range(0,len(fails),cols)],0)
    Image.fromarray((255*np.clip(sheet,0,1)**(1/2.2)).astype(np.uint8)).save('fails.png')
