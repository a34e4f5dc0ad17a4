#include <cmath>
#include <cstdint>
extern "C" {
// templates: (N,7,D) mask,col3,nor3 ; photo (4,H,W) r,g,b,v (zero outside)
void score(const float* tp,int size,const float* ph,int H,int W,const int* view,const float* tr,int count,float nvis,float sil,int shading,double* out){
  int D=size*size;
  for(int k=0;k<count;++k){
    const float* t=tp+(size_t)view[k]*7*D; const float* q=tr+k*5; // s*cos, s*sin, ox, oy, s
    double A[3][10]={},b[3][4]={},yy[3]={}; double Wt=0,Mt=0;
    for(int j=0;j<size;++j) for(int i=0;i<size;++i){
      int d=j*size+i; float m=t[d]; if(m<=0) continue; Mt+=m;
      float x=i+.5f-size*.5f,y=j+.5f-size*.5f;
      float px=q[0]*x-q[1]*y+q[2],py=q[1]*x+q[0]*y+q[3];
      int ix=(int)std::floor(px),iy=(int)std::floor(py);
      if(ix<0||iy<0||ix>=W-1||iy>=H-1) continue;
      float fx=px-ix,fy=py-iy; float w00=(1-fx)*(1-fy),w10=fx*(1-fy),w01=(1-fx)*fy,w11=fx*fy;
      const float* p=ph+(size_t)iy*W+ix; int HW=H*W;
      const float* pv=p+3*HW; float v=pv[0]*w00+pv[1]*w10+pv[W]*w01+pv[W+1]*w11;
      float w=m*v; if(w<=1e-3f) continue; Wt+=w;
      float B[4]={1,t[4*D+d],t[5*D+d],t[6*D+d]};
      for(int c=0;c<3;++c){
        const float* pc=p+c*HW; float yv=pc[0]*w00+pc[1]*w10+pc[W]*w01+pc[W+1]*w11;
        float a=t[(1+c)*D+d]; float wa=w*a, waa=wa*a;
        int z=0; for(int r=0;r<4;++r){ b[c][r]+=wa*B[r]*yv; for(int s=r;s<4;++s) A[c][z++]+=waa*B[r]*B[s]; }
        yy[c]+=w*yv*yv;
      }
    }
    double tot=0;
    for(int c=0;c<3;++c){
      double M[4][5]; int z=0; for(int r=0;r<4;++r){ for(int s=r;s<4;++s){M[r][s]=M[s][r]=A[c][z++];} M[r][4]=b[c][r]; }
      double A0[4][4]; for(int r=0;r<4;++r)for(int s=0;s<4;++s)A0[r][s]=M[r][s];
      double t0=A[c][0]+1e-9; for(int r=0;r<4;++r) M[r][r]+=t0*(r?(shading?.05:1e6):1e-6);
      for(int r=0;r<4;++r){ for(int s=r+1;s<4;++s){ double f=M[s][r]/M[r][r]; for(int u=r;u<5;++u) M[s][u]-=f*M[r][u]; } }
      double g[4]; for(int r=3;r>=0;--r){ double v=M[r][4]; for(int s=r+1;s<4;++s) v-=M[r][s]*g[s]; g[r]=v/M[r][r]; }
      double sse=yy[c]; for(int r=0;r<4;++r){ sse-=2*g[r]*b[c][r]; for(int s=0;s<4;++s) sse+=g[r]*A0[r][s]*g[s]; }
      if(sse<0) sse=0; tot+=std::log((sse+1e-4*Wt)/(Wt+1e-6));
    }
    double outside=nvis/(q[4]*q[4])-Wt; if(outside<0) outside=0;
    double J=Wt/(Wt+outside+.5*(Mt-Wt)+1e-6);
    out[k]=-.5*tot+sil*std::log(J+1e-3);
  }
}
}
