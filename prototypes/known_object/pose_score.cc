#include <cmath>
#include <cstdint>
#include <vector>
#include <algorithm>
static double NEFF=20,SG=.2,SK=.5;
extern "C" { void setp(double a,double b,double c){NEFF=a;SG=b;SK=c;}
// mesh P (V,3), F (F,3), uv (V,2), vn(V,3), tex (th,tw,3) linear; pose R(9) t(3); crop intrinsics f,cx,cy ; size Wc,Hc, ss
// photo (4,H,W)
struct Mesh{const float*P;const int*F;const float*uv;const float*vn;const float*tex;int nv,nf,tw,th;};
double pose_score(const Mesh*me,const float*R,const float*tr,float fx,float fy,float cx,float cy,const float*ph,int H,int W,int ss,float nvis,const float*box,float boxsig,float sil,float app,float sigma,float alpha,float*dbg){
  int SW=W*ss,SH=H*ss; static thread_local std::vector<float> X,Z; static thread_local std::vector<int> face; static thread_local std::vector<float> bary;
  X.resize(me->nv*3); Z.assign((size_t)SW*SH,0.f); face.assign((size_t)SW*SH,-1); bary.resize((size_t)SW*SH*2);
  float lo0=1e9,lo1=1e9,hi0=-1e9,hi1=-1e9;
  for(int i=0;i<me->nv;++i){ const float*p=me->P+3*i; float x=R[0]*p[0]+R[1]*p[1]+R[2]*p[2]+tr[0],y=R[3]*p[0]+R[4]*p[1]+R[5]*p[2]+tr[1],z=R[6]*p[0]+R[7]*p[1]+R[8]*p[2]+tr[2];
    if(z<1e-3f) return -1e9; float q=1/z; float u=fx*x*q+cx,v=fy*y*q+cy; X[3*i]=u*ss;X[3*i+1]=v*ss;X[3*i+2]=q; lo0=std::min(lo0,u);hi0=std::max(hi0,u);lo1=std::min(lo1,v);hi1=std::max(hi1,v);}
  for(int f=0;f<me->nf;++f){ const int*c=me->F+3*f; const float*a=&X[3*c[0]],*b=&X[3*c[1]],*d=&X[3*c[2]];
    float area=(b[0]-a[0])*(d[1]-a[1])-(b[1]-a[1])*(d[0]-a[0]); if(std::fabs(area)<1e-9f) continue;
    int x0=std::max(0,(int)std::ceil(std::min({a[0],b[0],d[0]})-.5f)),x1=std::min(SW-1,(int)std::floor(std::max({a[0],b[0],d[0]})-.5f));
    int y0=std::max(0,(int)std::ceil(std::min({a[1],b[1],d[1]})-.5f)),y1=std::min(SH-1,(int)std::floor(std::max({a[1],b[1],d[1]})-.5f));
    float inv=1/area;
    for(int y=y0;y<=y1;++y) for(int x=x0;x<=x1;++x){ float px=x+.5f,py=y+.5f;
      float w1=((px-a[0])*(d[1]-a[1])-(py-a[1])*(d[0]-a[0]))*inv, w2=((b[0]-a[0])*(py-a[1])-(b[1]-a[1])*(px-a[0]))*inv,w0=1-w1-w2;
      if(w0<0||w1<0||w2<0) continue; float q=w0*a[2]+w1*b[2]+w2*d[2]; size_t k=(size_t)y*SW+x; if(q>Z[k]){Z[k]=q;face[k]=f;bary[2*k]=w1;bary[2*k+1]=w2;}
    }}
  struct Px{float w,n[3],r[3],k[3];}; static thread_local std::vector<Px> px; px.clear(); const float EPS=.02f; double Wt=0,Mt=0; float is2=1.f/(ss*ss); size_t HW=(size_t)H*W;
  for(int y=0;y<H;++y) for(int x=0;x<W;++x){
    float m=0,col[3]={},nr[3]={};
    for(int j=0;j<ss;++j) for(int i=0;i<ss;++i){ size_t k=(size_t)(y*ss+j)*SW+x*ss+i; int f=face[k]; if(f<0) continue; m+=1;
      const int*c=me->F+3*f; float w1=bary[2*k],w2=bary[2*k+1],w0=1-w1-w2; const float*A_=&X[3*c[0]],*B_=&X[3*c[1]],*C_=&X[3*c[2]];
      float q=Z[k]; w0*=A_[2]/q; w1*=B_[2]/q; w2*=C_[2]/q;
      float u=w0*me->uv[2*c[0]]+w1*me->uv[2*c[1]]+w2*me->uv[2*c[2]],v=w0*me->uv[2*c[0]+1]+w1*me->uv[2*c[1]+1]+w2*me->uv[2*c[2]+1];
      u-=std::floor(u); v=1-v; v-=std::floor(v); float tx=u*me->tw-.5f,ty=v*me->th-.5f; int ix=(int)std::floor(tx),iy=(int)std::floor(ty); float ax=tx-ix,ay=ty-iy;
      int ix0=std::max(0,ix),ix1=std::min(me->tw-1,ix+1),iy0=std::max(0,iy),iy1=std::min(me->th-1,iy+1);
      for(int ch=0;ch<3;++ch){ auto T=[&](int yy_,int xx){return me->tex[((size_t)yy_*me->tw+xx)*3+ch];}; col[ch]+=(T(iy0,ix0)*(1-ax)+T(iy0,ix1)*ax)*(1-ay)+(T(iy1,ix0)*(1-ax)+T(iy1,ix1)*ax)*ay;
        nr[ch]+=w0*me->vn[3*c[0]+ch]+w1*me->vn[3*c[1]+ch]+w2*me->vn[3*c[2]+ch]; }
    }
    if(dbg){ for(int ch=0;ch<3;++ch) dbg[ch*HW+y*W+x]=m?col[ch]/m:0; dbg[3*HW+y*W+x]=m*is2; }
    if(m==0) continue; float im=1/m; m*=is2; Mt+=m; float v=ph[3*HW+y*W+x]; float w=m*v; if(w<=1e-3f) continue; Wt+=w;
    float n0[3]={nr[0]*im,nr[1]*im,nr[2]*im}; float B[4]={1,R[0]*n0[0]+R[1]*n0[1]+R[2]*n0[2],R[3]*n0[0]+R[4]*n0[1]+R[5]*n0[2],R[6]*n0[0]+R[7]*n0[1]+R[8]*n0[2]};
    Px p; p.w=w; p.n[0]=B[1];p.n[1]=B[2];p.n[2]=B[3]; for(int c=0;c<3;++c){ float yv=ph[c*HW+y*W+x],a=col[c]*im; p.r[c]=std::log(std::max(yv,0.f)+EPS)-std::log(a+EPS); p.k[c]=1; } px.push_back(p); }
  if(Wt<4) return -1e6;
  double g[6]={};
  double L=0; const double s2=sigma*sigma, b2=1.0; const double nb=std::pow(sigma,3)/std::pow(1.0,3)*(1-alpha)/alpha;
  for(int it=0;it<5;++it){
    double M[6][7]={}; L=0; double ww=0;
    for(auto&p:px){ double e=0; double sh=g[3]*p.n[0]+g[4]*p.n[1]+g[5]*p.n[2]; for(int c=0;c<3;++c){double d=p.r[c]-g[c]-sh; e+=d*d;}
      double in=std::exp(-.5*e/s2), ou=nb*std::exp(-.5*e/b2); double q= it==0?1:in/(in+ou)+ (ou/(in+ou))*s2/b2; if(it>0) L+=p.w*(std::log(in+ou)); 
      double w=p.w*q; for(int c=0;c<3;++c){ M[c][c]+=w; for(int k=0;k<3;++k){M[c][3+k]+=w*p.n[k]; } M[c][6]+=w*p.r[c]; for(int k=0;k<3;++k) M[3+k][6]+=w*p.n[k]*p.r[c]; }
      for(int k=0;k<3;++k)for(int l=k;l<3;++l) M[3+k][3+l]+=3*w*p.n[k]*p.n[l]; ww+=w; }
    if(it==4) break;
    for(int r=0;r<6;++r)for(int s_=0;s_<r;++s_)M[r][s_]=M[s_][r];
    { const double lg=s2*Wt/(NEFF*SG*SG), lk=s2*Wt/(NEFF*SK*SK); for(int r=0;r<3;++r)for(int c=0;c<3;++c)M[r][c]+=lg*((r==c)-1./3)+ (r==c)*1e-4*Wt; for(int r=3;r<6;++r)M[r][r]+=lk; }
    for(int r=0;r<6;++r)for(int s_=r+1;s_<6;++s_){double f=M[s_][r]/M[r][r];for(int u=r;u<7;++u)M[s_][u]-=f*M[r][u];}
    for(int r=5;r>=0;--r){double v=M[r][6];for(int s_=r+1;s_<6;++s_)v-=M[r][s_]*g[s_];g[r]=v/M[r][r];}
  }
  { double mg=(g[0]+g[1]+g[2])/3,pr=0; for(int c=0;c<3;++c)pr+=(g[c]-mg)*(g[c]-mg)/(SG*SG); for(int k=3;k<6;++k)pr+=g[k]*g[k]/(SK*SK); L-=.5*pr*Wt/NEFF; }
  double like=L/Wt;
  double outside=std::max(0.0,(double)nvis-Wt); double J=Wt/(Wt+outside+.5*(Mt-Wt)+1e-6);
  double score=app*like+sil*std::log(J+1e-3);
  if(box){ float d[4]={lo0-box[0],hi0-box[1],lo1-box[2],hi1-box[3]}; for(int i=0;i<4;++i){ double e=d[i]/boxsig; score-=.5*e*e/(1+.02*e*e);} }
  return score;
}
}
